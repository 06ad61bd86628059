"""config/fastdds.xml: shared memory that holds images."""

from pathlib import Path
from xml.etree import ElementTree

FILE = Path(__file__).resolve().parents[2] / "config" / "fastdds.xml"
NAMESPACE = {"dds": "http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"}
IMAGE_BYTES = 640 * 480 * 4
QUEUED_IMAGES = 10


def test_shared_memory_holds_a_queue_of_images():
    root = ElementTree.parse(FILE).getroot()
    sizes = [int(each.text) for each in root.iterfind(".//dds:segment_size", NAMESPACE)]
    assert sizes
    assert min(sizes) > QUEUED_IMAGES * IMAGE_BYTES


def test_the_profile_uses_the_transports_that_it_describes():
    root = ElementTree.parse(FILE).getroot()
    described = [
        e.text for e in root.iterfind(".//dds:transport_descriptor/dds:transport_id", NAMESPACE)
    ]
    used = [e.text for e in root.iterfind(".//dds:userTransports/dds:transport_id", NAMESPACE)]
    assert sorted(used) == sorted(described)
    (profile,) = root.iterfind(".//dds:participant", NAMESPACE)
    assert profile.get("is_default_profile") == "true"
