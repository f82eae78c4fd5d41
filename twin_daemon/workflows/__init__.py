"""What the commands and the Python API do: from recordings and a version to a result and a new version."""
