"""Wall-line SLAM: lines, scan matching, loop closures and the pose graph."""
