"""Joints that follow others: what is told of the joints of the wire, from what all of them do."""
