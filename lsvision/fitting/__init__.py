"""Points to ellipse and cylinder: conditioning and maximum likelihood. No cv2."""
