"""Install into this Python environment with uv, from the indexes that pip is configured for.

Arguments are those of `pip install`. uv resolves in a tenth of pip's processor time, but does not
read pip's configuration. Where uv cannot be installed or fails, pip installs. Run by `make`.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from ast import literal_eval
from pathlib import Path

PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check")

OPTIONS = {
    "index-url": "--default-index",
    "extra-index-url": "--index",
    "find-links": "--find-links",
    "trusted-host": "--allow-insecure-host",
    "constraint": "--constraint",
}
"""Options of uv, by names in pip's configuration; such a value is a list, split at white space."""

SECTIONS = ("global", "install", ":env:")
"""Sections of pip's configuration that apply; a later one wins."""

VARIABLES = {"cert": "SSL_CERT_FILE", "proxy": "ALL_PROXY"}
"""Environment variables of uv, by names in pip's configuration."""


def main() -> int:
    """Install what the command line says; return the status of the program that installed."""
    if importlib.util.find_spec("uv") is None:
        subprocess.run([*PIP, "install", "-qq", "--no-compile", "uv"], check=False)
    program = Path(sys.executable).with_name("uv")
    if program.exists():
        listed = subprocess.check_output([*PIP, "config", "list"], text=True)
        options, variables = as_uv(listed)
        command = [program, "pip", "install", "-q", "--python", sys.executable, *options]
        if subprocess.call([*command, *sys.argv[1:]], env=variables | os.environ) == 0:
            return 0
    return subprocess.call([*PIP, "install", "-qq", "--no-compile", *sys.argv[1:]])


def as_uv(listed: str) -> tuple[list[str], dict[str, str]]:
    """Return options and environment variables of uv from the output of `pip config list`."""
    settings = dict[str, str]()
    for section in SECTIONS:
        for line in listed.splitlines():
            if line.startswith(f"{section}."):
                name, value = line.removeprefix(f"{section}.").split("=", 1)
                settings[name] = literal_eval(value)
    # Like pip, uv takes the best version on any index.
    options = ["--index-strategy", "unsafe-best-match"]
    for name, option in OPTIONS.items():
        options += [word for value in settings.get(name, "").split() for word in (option, value)]
    if settings.get("no-index", "").lower() in ("1", "true", "yes", "on"):
        options.append("--no-index")
    return options, {VARIABLES[n]: value for n, value in settings.items() if n in VARIABLES}


if __name__ == "__main__":
    sys.exit(main())
