"""Recordings: bags and CARMEN logs, read, written and recovered."""
