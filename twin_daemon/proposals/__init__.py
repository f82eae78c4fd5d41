"""Laws that nobody wrote: what the twin lacks where no effect of the library fits, as a proposal with its evidence."""
