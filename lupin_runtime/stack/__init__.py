"""The table of the runtime's processes, the program that runs one of them, and the supervisor behind `lupin up`."""
