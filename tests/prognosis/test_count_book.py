"""Counts of service life reach the unit that they are of, and no other."""

from ema_monitor.prognosis.count_book import CountBook
from ema_monitor.prognosis.counts import Count

SECOND_NS = 1_000_000_000


def count(number: int) -> Count:
    return Count(number * SECOND_NS, float(number), 0)


def test_counts_go_to_the_unit_that_they_name():
    book = CountBook()
    for number, serial_number in enumerate(("A", "B", "A")):
        book.add("flap", serial_number, count(number))
    book.add("rudder", "A", count(9))
    assert book.take("flap", "A") == [count(0), count(2)]
    # Each is told once.
    assert book.take("flap", "A") == []
    assert book.take("flap", "B") == [count(1)]
    assert book.take("rudder", "A") == [count(9)]


def test_counts_before_any_description_wait_for_the_first_one():
    book = CountBook()
    book.add("flap", "B", count(1))
    book.add("flap", "", count(2))
    book.add("flap", "", count(3))
    book.add("rudder", "", count(4))
    book.name("flap", "A")
    book.name("flap", "B")
    assert book.take("flap", "A") == [count(2), count(3)]
    assert book.take("flap", "B") == [count(1)]
    assert book.take("rudder", "A") == []


def test_of_counts_of_one_stamp_one_that_names_the_unit_holds():
    book = CountBook()
    book.add("flap", "", Count(1, 5.0, 0))
    book.add("flap", "A", Count(1, 6.0, 0))
    book.name("flap", "A")
    assert [item.hours for item in book.take("flap", "A")] == [6.0]


def test_what_nobody_asks_for_is_kept_within_bounds():
    book = CountBook()
    for number in range(1500):
        book.add("flap", f"{number}", count(number))
        book.add("flap", "0", count(number))
    # Heard of all the time, and the latest hundred counts of it.
    assert book.take("flap", "0") == [count(number) for number in range(1400, 1500)]
    assert book.take("flap", "1499") == [count(1499)]
    assert book.take("flap", "400") == []


def test_hundred_counts_a_second_do_not_push_out_the_one_that_applies():
    book = CountBook()
    book.add("flap", "A", count(0))
    for number in range(5000):
        book.add("flap", "A", Count(SECOND_NS + number * SECOND_NS // 100, 7.0, 0))
    kept = book.take("flap", "A")
    assert kept[0] == count(0)
    # One a second.
    assert len(kept) == 51
