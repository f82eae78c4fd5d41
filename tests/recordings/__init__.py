"""Readers and the writer of recordings, against files that rosbags wrote."""
