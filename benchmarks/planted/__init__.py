"""The planted-effect study: whether the diagnosis names what was put into a run, and is silent where nothing was."""
