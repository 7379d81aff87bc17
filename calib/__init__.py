"""Camera calibration: from control points to a ground homography or camera with its covariance."""
