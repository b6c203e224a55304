"""The report of a finding as an HTML page, with drawings first and their numbers beside them."""
