"""Sound of a clip: stereo samples of impacts, sliding and rolling.

Modal synthesis (van den Doel and Pai, Presence 7, 382, 1998): an impact excites the
modes of both bodies with a pulse of Hertz's contact time.
"""
