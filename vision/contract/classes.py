"""Names of vehicle classes, and how else they are spelled."""

import re

VEHICLES = ("car", "van", "bus", "truck", "motorcycle", "vehicle")

SPELLINGS = {
    "motorbike": "motorcycle",
    "motor bike": "motorcycle",
    "motor cycle": "motorcycle",
    "motor": "motorcycle",
    "motorcyclist": "motorcycle",
    "scooter": "motorcycle",
    "moped": "motorcycle",
    "auto": "car",
    "automobile": "car",
    "passenger car": "car",
    "passengercar": "car",
    "pkw": "car",
    "sedan": "car",
    "hatchback": "car",
    "suv": "car",
    "taxi": "car",
    "car with trailer": "car",
    "lorry": "truck",
    "heavy truck": "truck",
    "hgv": "truck",
    "lkw": "truck",
    "rigid truck": "truck",
    "truck with trailer": "truck",
    "truck with semitrailer": "truck",
    "minivan": "van",
    "delivery van": "van",
    "delivery van with trailer": "van",
    "private van": "van",
    "private van with trailer": "van",
    "coach": "bus",
    "city bus": "bus",
    "autobus": "bus",
    "bike": "bicycle",
    "cyclist": "bicycle",
    "bicyclist": "bicycle",
    "bicyclist with trailer": "bicycle",
    "cargo bike driver": "bicycle",
    "pedestrian": "person",
    "people": "person",
}


def plain_name(name: str) -> str:
    """Spell a class name as this package does.

    >>> plain_name("Motorbike"), plain_name("motor-cycle"), plain_name("car")
    ('motorcycle', 'motorcycle', 'car')
    """
    name = re.sub(r"[\s_-]+", " ", name).strip().lower()
    return SPELLINGS.get(name, name)
