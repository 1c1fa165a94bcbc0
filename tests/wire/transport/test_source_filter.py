from wire.transport.mocap_bus import SILENT_NS, SourceFilter


def test_a_second_publisher_is_rejected_while_the_first_is_heard():
    source = SourceFilter()
    for k in range(100):
        now_ns = k * 10_000_000
        assert not source.rejects(b"first", now_ns)
        source.accept(b"first", now_ns)
        assert source.rejects(b"second", now_ns + 5_000_000)


def test_a_silent_publisher_is_replaced_and_rejected_when_it_comes_back():
    source = SourceFilter()
    source.accept(b"first", 0)
    assert source.rejects(b"second", SILENT_NS - 1)
    assert not source.rejects(b"second", SILENT_NS)
    source.accept(b"second", SILENT_NS)
    assert source.rejects(b"first", SILENT_NS + 1)


def test_what_is_not_used_keeps_no_place():
    source = SourceFilter()
    assert not source.rejects(b"garbage", 0)
    assert not source.rejects(b"first", 1)
