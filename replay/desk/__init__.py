"""``replay serve``: the diagnosis on a page of this machine."""
