"""The seeing operator's vision of one image: detections with measured uncertainty."""
