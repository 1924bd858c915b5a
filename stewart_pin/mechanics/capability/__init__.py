"""What a robot can do at one configuration: how fast, how strong, and in which direction least."""
