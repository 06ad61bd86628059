"""The factors of the wall graph, one small class each.

A factor is data plus one method that adds its GTSAM form to a graph. A new kind of landmark is one
class derived from `LandmarkFactor`, in a module here or outside of the package. Variables are named
by `Key`: keyframes and views are spatial poses (``gtsam.Pose3``), walls and surfaces are planes
(``gtsam.OrientedPlane3``). A factor that brings a variable of its own says where it starts by
`initial`.

GTSAM orders the tangent of a pose (roll, pitch, yaw, x, y, z), in the body's frame.
"""
