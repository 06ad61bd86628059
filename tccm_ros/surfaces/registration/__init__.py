"""Registration: relative poses of views from the surfaces that they share."""
