"""Machine and limits to the best motion between two rests; knows no bus."""
