"""Print what an agent hears from `tccm mcp MAP`, as the transcript of docs/guides/agents.md.

Usage: python tools/ask_as_agent.py MAP
"""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path
from typing import Any

from mcp import Client, StdioServerParameters, stdio_client

QUESTIONS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("overview", {}),
    ("find_surfaces", {"words": "table", "min_height_m": 0.6, "limit": 1}),
    ("objects_on", {"surface_id": 3, "limit": 1}),
    ("find_placements", {"words": "counter", "length_m": 0.1, "width_m": 0.1, "height_m": 0.12,
                         "limit": 1}),
    ("how_to_approach", {"surface_id": 3, "limit": 1}),
    ("changes_since", {"stamp_s": 1600000080.0, "limit": 2}),
    ("objects_on", {"surface_id": 999}),
)  # fmt: skip
"""Asked one after the other."""


async def ask(saved: str) -> None:
    """Print questions and answers."""
    command = str(Path(sys.executable).parent / "tccm")
    parameters = StdioServerParameters(command=command, args=["mcp", saved])
    async with Client(stdio_client(parameters)) as client:
        for tool, arguments in QUESTIONS:
            answer = await client.call_tool(tool, arguments)
            text = answer.structured_content or {"error": answer.content[0].text}
            print(f"> {tool} {json.dumps(arguments)}\n{json.dumps(text)}\n")


if __name__ == "__main__":
    asyncio.run(ask(sys.argv[1]))
