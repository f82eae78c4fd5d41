"""Joins a ROS 2 system and the twin, which speaks Zenoh. The only package that imports rclpy, and only when it runs."""
