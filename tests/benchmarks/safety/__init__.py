"""Does anything end in a contact, a crash or a hang?"""
