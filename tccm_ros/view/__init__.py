"""Views of a map: a Rerun recording and a live page. Both need the extra `view`."""
