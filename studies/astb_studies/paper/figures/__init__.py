"""The paper's figures 5 to 11: the bench as points, the plant's model as lines, the paper's closed forms dashed."""
