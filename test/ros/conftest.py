import pytest
from message_families import family


@pytest.fixture(params=["typestore", "rosidl"])
def types(request):
    """Return the message classes of one family, rosidl or rosbags."""
    return family(request.param)
