"""A route for surveyors: files of geographic information systems and CAD, accuracy classes, a sheet for the file."""
