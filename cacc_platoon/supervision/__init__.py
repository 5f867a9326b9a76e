"""The processes of a run: who starts them, what they tell each other, how the run ends."""
