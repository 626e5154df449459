"""Did an answer change where only code was moved?"""
