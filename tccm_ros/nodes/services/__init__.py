"""Services, actions and topics of the nodes for other programs."""
