"""Logs of CAN frames that other programs wrote, read line by line: what is no data frame is counted."""
