import pytest
from message_families import family


@pytest.fixture(params=["typestore", "rosidl"])
def types(request):
    """Message classes of either family."""
    return family(request.param)
