"""Why a file does not fit: what explains an error better than a poor estimate does."""
