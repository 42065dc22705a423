"""The process table of the whole runtime, how a process of it runs, and the supervisor behind `lupin up`."""
