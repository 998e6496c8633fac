"""The planted-effect study: does the diagnosis name what was put into a run, and stay silent where nothing was?"""
