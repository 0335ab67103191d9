"""Camera frames to markers, metres and forward speed."""
