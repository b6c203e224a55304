"""The test plans: a file each, or one for both loads; every plan in here is found by itself."""
