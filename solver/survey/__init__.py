"""What is measured: site.toml, DAS files, anchors, dead channels."""
