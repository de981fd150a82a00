"""What the operator who sees makes of one picture: detections with measured uncertainty."""
