"""The pose validator: rejects impossible poses, body by body. A rejected pose counts as not seen and has a reason.

validator  capture times, then poses: the entry                 judge   all checks of one frame's poses, compiled
checks     names, limits and words; the manual's table          bounds  what each body can do, from its profile
episodes   events of rejections                                 armed   which drones have their motors on
"""
