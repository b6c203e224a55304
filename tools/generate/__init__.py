"""Writes the files that are generated from the tables: DBC, EDS, register map and reference pages."""
