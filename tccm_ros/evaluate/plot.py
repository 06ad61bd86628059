"""Plot of a trajectory's score."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tccm_ros.atomic import output_file
from tccm_ros.evaluate.score import TrajectoryScore


def plot_score(score: TrajectoryScore, path: Path | str) -> None:
    """Draw both trajectories, if there are any, and the cumulative errors as PNG, without metadata.

    Raises
    ------
    OutputError
        If the picture cannot be written.
    """
    figure = Figure(figsize=(12.0, 5.5), layout="constrained")
    FigureCanvasAgg(figure)
    way, spread = figure.subplots(1, 2)
    if len(score.truth):
        way.plot(*score.truth.T, color="#888888", linewidth=2.5, label="truth")
        way.plot(*score.positions.T, color="#c03020", linewidth=1.0, label="trajectory, aligned")
        way.legend()
    way.set_aspect("equal")
    way.set_xlabel("x, m")
    way.set_ylabel("y, m")
    for name, errors in score.errors.items():
        if len(errors):
            ordered = np.sort(errors.translation)
            spread.plot(ordered, np.arange(1, len(ordered) + 1) / len(ordered), label=name)
    spread.set_xlabel("translation error, m")
    spread.set_ylabel("fraction of pairs below")
    spread.set_ylim(0.0, 1.0)
    spread.set_xlim(left=0.0)
    spread.grid(alpha=0.3)
    spread.legend(fontsize=8)
    with output_file(path) as made:
        figure.savefig(made, format="png", dpi=100, metadata={"Software": None})
