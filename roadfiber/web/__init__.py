"""Pages in the browser that this machine serves to itself alone: the workbench, and the start of a survey."""

from vision.contract.extras import require_extra

require_extra("workbench", ("panel", "bokeh"), "pages in the browser")
