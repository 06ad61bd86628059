"""Run every benchmark, one after the other: `make bench`.

Each is also a command of its own. Tables are Markdown; times are of this machine in this run, and
what counts are the ratios to the peers in the same run.
"""

import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent


def main() -> int:
    """Run them; return how many failed."""
    failed = 0
    for path in sorted(HERE.glob("bench_*.py")):
        print(f"\n## {path.stem}\n", flush=True)
        failed += subprocess.run([sys.executable, str(path)], check=False).returncode != 0
    return failed


if __name__ == "__main__":
    sys.exit(main())
