"""Launch files, configuration, the campaign runner and the console."""
