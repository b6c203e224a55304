"""What the next plan meets after a commander or something else was lost: every kind of loss before every plan."""
