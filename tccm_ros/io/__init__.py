"""Files: bags, CARMEN logs, saved maps and exports."""
