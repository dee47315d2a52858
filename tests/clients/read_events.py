"""Reads a training's event files with TensorBoard's own reader and compares them with its log.

    read_events.py TRAINING

TRAINING is the folder of a training. Any disagreement ends it with an error.
"""

import csv
import pathlib
import sys

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator


def scalars(network):
    """By tag, the values by epoch. An epoch that is there twice is an error."""
    accumulator = EventAccumulator(str(network))
    accumulator.Reload()
    found = {}
    for tag in accumulator.Tags()["scalars"]:
        events = accumulator.Scalars(tag)
        found[tag] = {event.step: event.value for event in events}
        assert len(found[tag]) == len(events), f"{network.name}, {tag}: an epoch is there twice"
    return found


def main():
    training = pathlib.Path(sys.argv[1])
    with open(training / "log.csv", newline="") as log:
        lines = list(csv.DictReader(log))
    networks = {path.name: scalars(path) for path in (training / "tensorboard").iterdir()}
    assert set(networks) == {line["stage"] for line in lines}, networks.keys()
    compared = 0
    for line in lines:
        found = networks[line["stage"]]
        columns = {"rate": "rate", "loss": "loss", "excess": "excess"}
        columns |= {f"excess of/{name[7:]}": name for name in line if name.startswith("excess_") and line[name]}
        assert set(found) == set(columns), f"{line['stage']}: {set(found) ^ set(columns)}"
        for tag, column in columns.items():
            value, written = found[tag][int(line["epoch"])], float(line[column])
            assert abs(value - written) <= 1e-6 + 1e-6 * abs(written), f"{line}, {tag}: {value}"
            compared += 1
    count = sum(len(values) for found in networks.values() for values in found.values())
    assert count == compared, f"{count} values in the event files, {compared} in the log"
    print(f"{compared} values of {len(lines)} epochs")


if __name__ == "__main__":
    main()
