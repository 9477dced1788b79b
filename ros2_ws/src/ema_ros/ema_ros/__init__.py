"""Code shared by all nodes: messages, topics and QoS, lifecycle, parameters, status."""
