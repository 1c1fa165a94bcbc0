"""What QTM sends, written by hand from the tables and examples of Qualisys' QTM RT protocol documentation.

FRAME: 6D of two bodies, 5000 s after the start, number 70,000; the first turned by 90 degrees about z, its matrix
column by column, the second lost. PARAMETERS: as version 1.19 writes them, and 1.25, in the forms of its example and
of the test data of the C++ SDK, shortened.
"""

WELCOME = bytes.fromhex("2300000001000000") + b"QTM RT Interface connected\0"
VERSION_SET = bytes.fromhex("1c00000001000000") + b"Version set to 1.19\0"
NO_PARAMETERS = bytes.fromhex("2100000000000000") + b"Parameters not available\0"
NO_MORE_DATA = bytes.fromhex("0800000004000000")
SETTINGS_CHANGED = bytes.fromhex("09000000060000000b")
SHUTTING_DOWN = bytes.fromhex("09000000060000000c")

_NAN = "0000c07f"
FRAME = bytes.fromhex(
    "88000000" "03000000"  # 136 bytes, data
    "00f2052a01000000" "70110100" "01000000"  # stamp, us; number; one component
    "70000000" "05000000" "02000000" "0000" "0000"  # 112 bytes, 6D, two bodies
    "00107a44" "00807ac3" "0080bb44"  # 1000.25, -250.5, 1500
    "00000000" "0000803f" "00000000" "000080bf" "00000000" "00000000" "00000000" "00000000" "0000803f"
) + bytes.fromhex(12 * _NAN)  # fmt: skip

PARAMETERS_1_19 = """<QTM_Parameters_Ver_1.19>
    <The_6D>
        <Bodies>2</Bodies>
        <Body>
            <Name>Body1</Name>
            <RGBColor>ffffff</RGBColor>
            <Point><X>10.5</X><Y>9.5</Y><Z>10.5</Z><Virtual>False</Virtual><PhysicalId>1</PhysicalId></Point>
        </Body>
        <Body>
            <Name>Body &amp; 2</Name>
            <RGBColor>ffffff</RGBColor>
        </Body>
        <Euler><First>Roll</First><Second>Pitch</Second><Third>Yaw</Third></Euler>
    </The_6D>
</QTM_Parameters_Ver_1.19>"""

PARAMETERS_1_25 = """<QTM_Parameters_Ver_1.25>
    <The_6D>
        <Body>
            <Name>refined</Name>
            <Enabled>true</Enabled>
            <Mesh><Name>Arqus.obj</Name></Mesh>
        </Body>
        <Body>
            <Name>Table</Name>
            <Mesh><Name/></Mesh>
        </Body>
    </The_6D>
</QTM_Parameters_Ver_1.25>"""


def xml(parameters: str) -> bytes:
    """A packet of them."""
    return (9 + len(parameters)).to_bytes(4, "little") + b"\2\0\0\0" + parameters.encode() + b"\0"
