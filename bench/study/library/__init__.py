"""Studies that come with the bench, as YAML files beside this module."""
