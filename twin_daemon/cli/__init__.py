"""The command line. Each command is one module; `app` lists them and loads only the one that is called."""
