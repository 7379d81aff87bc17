"""Fits of a fiber route: the problem, its priors, the spline fit, and the result that every fit returns."""
