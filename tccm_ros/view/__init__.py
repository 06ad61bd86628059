"""Views of a map: a Rerun recording, and a live page. Each needs the extra `view`."""
