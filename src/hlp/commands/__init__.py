"""What each `hlp COMMAND` does with its arguments; what is heavy is imported when needed."""
