"""Model against measurement: where, when and how they differ, in numbers, pictures and words."""
