"""The test plans, one per file (or one file for both loads); `test_plans.discovery` finds all plans of this folder."""
