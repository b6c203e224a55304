"""Logs of CAN frames from other programs, read line by line; entries that are not data frames are counted."""
