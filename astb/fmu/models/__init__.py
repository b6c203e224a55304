"""What can be written as an FMU."""
