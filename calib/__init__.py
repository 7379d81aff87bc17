"""Camera calibration: control points in, a ground homography or camera with honest errors out."""
