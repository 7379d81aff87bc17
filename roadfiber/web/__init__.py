"""Pages in the browser that this machine serves to itself alone: the workbench, and the start of a survey."""
