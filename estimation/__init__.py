"""What the user asks for: recordings, studies, smoothing and their results."""
