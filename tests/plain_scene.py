"""The scene that tests of peers put one material into: a sphere under a white sky."""

import engines


def plain_scene(**material):
    return engines.scene_from(
        {
            "raybench_scene": 1,
            "name": "plain",
            "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
            "materials": {"it": material or {"kd": 0.5}},
            "shapes": [{"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "it"}],
            "lights": [{"environment": {"radiance": 1}}],
        }
    )
