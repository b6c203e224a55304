"""The twin: the model runs in parallel to a run of the rig, and reports when, where and since when the two deviate."""
