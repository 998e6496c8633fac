"""The application: commands, station, runner, run store, analysis, diagnosis, report."""
