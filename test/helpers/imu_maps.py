"""Maps of one simulated drive with and without an IMU."""

from tccm_ros.config import Config
from tccm_ros.mapping.surface_slam import SurfaceSolution
from tccm_ros.records import Imu
from tccm_ros.replay.processors import Pipeline
from tccm_sim.engine import Simulation
from tccm_sim.options import Options
from tccm_sim.worlds import build_world


def role_of(simulation: Simulation, topic: str) -> str:
    """Return the role of a topic of a simulated rig."""
    roles = {name: role for role, name in vars(simulation.rig.topics).items()}
    return roles.get(topic, topic.removeprefix("/"))


def map_with_and_without_imu(
    world: str, seed: int, options: Options
) -> tuple[Simulation, SurfaceSolution, SurfaceSolution]:
    """Return the simulation of a drive, its map with the records of the IMU, and one without."""
    simulation = Simulation(build_world(world, options), seed, options)
    both = [Pipeline(Config(), expects_odometry=True) for _ in range(2)]
    for message in simulation.run():
        role = role_of(simulation, message.topic)
        for record in message.records:
            for pipeline in both[:1] if isinstance(record, Imu) else both:
                pipeline.add(role, record)
    for pipeline in both:
        pipeline.finish()
    return simulation, both[0].solve(), both[1].solve()
