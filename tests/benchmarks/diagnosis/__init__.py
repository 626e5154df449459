"""Is what a simulated flight lacks named, and nothing else?"""
