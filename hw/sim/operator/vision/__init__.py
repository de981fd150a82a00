"""What the seeing operator makes of one image: detections with measured uncertainty."""
