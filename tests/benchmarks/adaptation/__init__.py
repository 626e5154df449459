"""Does what is learnt in flight help?"""
