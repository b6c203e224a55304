"""What can be told of a rig before a plan runs on it: by listening, and by one small move of each axis."""
