"""The figures of a study, each with its numbers apart from its drawing where there are numbers to prepare."""
