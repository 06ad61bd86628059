"""Files that the first worker that needs them creates, once in a test session."""

import fcntl
import hashlib
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from split_bag import split_bag

from tccm_ros.config import Config
from tccm_ros.replay.replay import replay
from tccm_sim.options import Options
from tccm_sim.recording import simulate

BAGS = Path(__file__).resolve().parents[2] / "bags"


class SessionFiles:
    """Common folder of all workers of a session.

    Tests that change a file must copy it.
    """

    def __init__(self, root: Path):
        self._root = root
        root.mkdir(exist_ok=True)

    def once(self, name: str, make: Callable[[Path], object]) -> Path:
        """Return a path that `make` writes on the first call; concurrent calls wait for it."""
        path = self._root / name
        with (self._root / f"{name}.lock").open("a") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not path.exists():
                with TemporaryDirectory(dir=self._root) as unfinished:
                    make(Path(unfinished) / name)
                    (Path(unfinished) / name).rename(path)
        return path

    def replayed(self, bag: str) -> Path:
        """Return the results of a bundled bag with default parameters, without pictures."""

        def make(out: Path) -> None:
            summary = replay(BAGS / bag, out, Config(), pictures=False)
            (self._root / f"replayed_{bag}.txt").write_text(summary.text())

        return self.once(f"replayed_{bag}", make)

    def said(self, bag: str) -> str:
        """Return the text that the replay of `replayed` ends with."""
        return self.replayed(bag).with_suffix(".txt").read_text()

    def replayed_halves(self) -> tuple[Path, Path]:
        """Return the results of two halves of the flat, each in a frame of its own."""

        def make(out: Path) -> None:
            out.mkdir()
            halves = split_bag(BAGS / "flat" / "flat.mcap", out, 2, overlap_s=6.0)
            for name, bag in zip(("first", "second"), halves):
                replay(bag, out / name, Config(), pictures=False)

        folder = self.once("halves", make)
        return folder / "first", folder / "second"

    def simulated(self, world: str, *, seed: int = 0, **options) -> Path:
        """Return the recording of a simulated world with some options."""
        wanted = Options(**options)
        key = hashlib.sha256(repr((seed, wanted)).encode()).hexdigest()[:12]
        return self.once(
            f"{world}_{key}", lambda out: simulate(world, out, seed=seed, options=wanted)
        )
