"""Shows hand and twin in Foxglove, live. The only package that imports the Foxglove SDK, and only when it runs."""
