"""The test plans of the bench, and what they are made of; `test_plans.discovery` finds them."""
