"""A recording split into parts, as of robots that drive one after the other."""

from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import Writer

STATIC = ("/robot_description", "/tf_static")


def split_bag(path, folder, parts, overlap_s=0.0):
    """Write consecutive parts of an mcap, each with the description; return their paths.

    Parts overlap by `overlap_s`.
    """
    with Path(path).open("rb") as stream:
        messages = [(schema, channel, m) for schema, channel, m in
                    make_reader(stream).iter_messages()]  # fmt: skip
    first, last = messages[0][2].log_time, messages[-1][2].log_time
    step = (last - first) / parts
    paths = []
    for k in range(parts):
        begin, end = first + k * step - overlap_s * 1e9, first + (k + 1) * step
        part = Path(folder) / f"part_{k}.mcap"
        part.parent.mkdir(parents=True, exist_ok=True)
        _write(part, messages, begin, end)
        paths.append(part)
    return paths


def _write(path, messages, begin, end):
    with path.open("wb") as stream:
        writer = Writer(stream, enable_crcs=True, enable_data_crcs=True)
        writer.start(profile="ros2", library="tccm_ros")
        channels = {}
        for schema, channel, m in messages:
            is_static = channel.topic in STATIC and m.log_time < begin
            if not (is_static or begin <= m.log_time <= end):
                continue
            if channel.topic not in channels:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, known, channel.metadata
                )
            log_time = max(m.log_time, int(begin))
            writer.add_message(channels[channel.topic], log_time, m.data, log_time, m.sequence)
        writer.finish()
