"""What a diagnosis answers, and how that is said: verdict, findings, regimes, the repaired model, words."""
