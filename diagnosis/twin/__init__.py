"""The twin: the model runs during a run of the rig, and reports when, where and since when the two deviate."""
