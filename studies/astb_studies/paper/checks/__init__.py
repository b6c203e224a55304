"""The paper's claims T1 to T11 and our acceptance checks A01 to A30, each next to the function that decides it."""
