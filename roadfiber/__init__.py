"""Video and Distributed Acoustic Sensing (DAS) to a fiber route with honest uncertainty."""
