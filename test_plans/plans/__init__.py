"""The test plans, one per file. A file may contain one plan for each load. `test_plans.discovery` finds all plans of
this folder.
"""
