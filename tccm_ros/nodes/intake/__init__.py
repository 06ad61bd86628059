"""Inputs of a node: subscriptions, the thread that takes messages, the robot, diagnostics."""
