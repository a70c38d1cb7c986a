"""The command line and all that puts concrete parts together: pipeline, simulator, plots and reports."""
