"""What the operator who sees makes of one image: detections with measured uncertainty."""
