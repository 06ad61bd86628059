"""Scan matching: a level scan against a local map."""
