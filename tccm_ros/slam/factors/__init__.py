"""The factors of the wall graph, one small class each.

A factor is data plus one method that adds its GTSAM form to a graph. A new kind of landmark is a
class derived from `LandmarkFactor`, in this package or outside. Variables are named by `Key`:
keyframes and views are spatial poses (``gtsam.Pose3``), walls are planes
(``gtsam.OrientedPlane3``). A factor with a variable of its own returns its start value from
`initial`.

The tangent of a pose in GTSAM has the order (roll, pitch, yaw, x, y, z), in the body frame.
"""
