"""Write what is made from the code in docs: parameters, command line, schemas, and code in pages.

A page has the code of a file after `<!-- code: PATH -->`, or after `<!-- code: PATH:NAME -->` that
between the lines `# [NAME]` and `# [/NAME]`, so that it is read wherever Markdown is shown.

Usage: python tools/make_reference.py (`make reference`)
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import typer

from tccm_ros.cli import app
from tccm_ros.config import parameters
from tccm_ros.config.reference import range_text, value_text

ROOT = Path(__file__).resolve().parents[1]
REFERENCE = ROOT / "docs" / "reference"

PARAMETERS = """\
# Parameters

Made from the configuration by `make reference`. A parameter is set by `--set group.key=value`, in
a YAML file (`--config FILE`, or `--ros-args --params-file FILE` of a node), or as a ROS parameter
of a node. Parameters fixed at start cannot be changed while a node runs.
[Tuning](../guides/tuning.md) leads from symptoms to parameters.

"""

COMMANDS = """\
# Command line

Made from the help of `tccm` by `make reference`. Exit status: 0 done; 1 an error that one line
explains; 2 wrong usage. `tccm --debug COMMAND` shows the traceback of an error. Outputs
are complete or absent.

"""

CODE = re.compile(
    r"(?s)(?P<mark><!-- code: (?P<path>[^\s:]+)(?::(?P<name>\w+))? -->\n```python\n).*?(?=```)"
)
SCHEMAS = re.compile(r"(?s)(<!-- schemas -->\n).*?(?=<!-- /schemas -->)")


def parameter_page() -> str:
    """Return the page of all parameters."""
    rows = ["| parameter | default | unit | range | meaning |", "|---|---|---|---|---|"]
    for p in parameters():
        default = "empty" if p.default in (None, "") else value_text(p.default)
        fixed = " (fixed at start)" if p.read_only else ""
        rows.append(f"| `{p.name}` | {default} | {p.unit} | {range_text(p)} | {p.meaning}{fixed} |")
    return PARAMETERS + "\n".join(rows) + "\n"


def command_line() -> str:
    """Return the page of all commands, in the order of the help."""
    group = typer.main.get_command(app)
    context = typer.Context(group, info_name="tccm")
    names = group.list_commands(context)
    return COMMANDS + "\n".join(_command(name, group.get_command(context, name)) for name in names)


def _command(name: str, command: typer.core.TyperCommand) -> str:
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    usage = " ".join(["tccm", name, *map(_usage_word, arguments), "[OPTIONS]"])
    lines = [f"## tccm {name}", "", command.help or "", "", "```", usage, "```", ""]
    rows = [*map(_argument, arguments), *_options(command)]
    head = ["| | meaning | default |", "|---|---|---|"] if rows else []
    return "\n".join([*lines, *head, *rows]).rstrip() + "\n"


def _usage_word(argument: typer.core.TyperArgument) -> str:
    name = argument.name.upper().removesuffix("S" if argument.nargs == -1 else "")
    name = name if argument.nargs != -1 else f"{name} [{name} ...]"
    return name if argument.required else f"[{name}]"


def _argument(parameter: typer.core.TyperArgument) -> str:
    return f"| `{parameter.name}` | {parameter.help} | {_default(parameter)} |"


def _options(command: typer.core.TyperCommand) -> Iterator[str]:
    for option in command.params:
        if option.param_type_name == "option":
            names = ", ".join(f"`{name}`" for name in (*option.opts, *option.secondary_opts))
            yield f"| {names} | {option.help} | {_default(option)} |"


def _default(parameter: typer.core.TyperArgument | typer.core.TyperOption) -> str:
    if parameter.required:
        return "required"
    default = parameter.default
    if isinstance(default, bool) and not parameter.secondary_opts:
        return ""
    if isinstance(default, bool):
        default = (parameter.opts if default else parameter.secondary_opts)[0]
    return "" if default in (None, [], ()) else f"`{default}`"


def files() -> str:
    """Return the page of file formats with the schemas that there are."""
    page = (REFERENCE / "files.md").read_text(encoding="utf-8")
    schemas = sorted(path.name for path in (REFERENCE / "schema").glob("*.json"))
    rows = "".join(f"- [`{name}`](schema/{name})\n" for name in schemas)
    return SCHEMAS.sub(lambda match: match[1] + rows, page)


def pages() -> dict[Path, str]:
    """Return the text of each page that is made here."""
    texts = {
        "parameters.md": parameter_page(),
        "command_line.md": command_line(),
        "files.md": files(),
    }
    made = {REFERENCE / name: text for name, text in texts.items()}
    with_code = (p for p in sorted(ROOT.glob("docs/**/*.md")) if CODE.search(p.read_text()))
    return made | {page: CODE.sub(_with_code, page.read_text()) for page in with_code}


def _with_code(found: re.Match[str]) -> str:
    """Return the mark of a piece of code, and the code."""
    code, name = (ROOT / found["path"]).read_text(), found["name"]
    if name is not None:
        code = code.partition(f"# [{name}]\n")[2].partition(f"# [/{name}]\n")[0].strip() + "\n"
    return found["mark"] + code


if __name__ == "__main__":
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")
