"""The live page of a run: a folder that another process writes, shown in a browser while it grows.

Everything here only reads the run folder. What is shown is one JSON document (:mod:`bench.watch.document`); the page
asks for it again whenever the server says that it changed.
"""
