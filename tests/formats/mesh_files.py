"""Files of a box from -1 to 1 in each axis, written as other people's programs write meshes."""

import struct

POINTS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TRIANGLES = [(a, *pair) for a, b, c, d in QUADS for pair in ((b, c), (c, d))]
#: The top is seen last, first as triangle strips: a strip of four sides, and two of a side.
STRIPS = [[0, 4, 1, 5, 3, 7, 2, 6, 0, 4], [0, 2, 4, 6, -1, 1, 5, 3, 7]]


def lines(word, rows, form="{}"):
    return "".join(
        f"{word} {' '.join(form.format(value) for value in row)}\n" for row in rows
    ).replace("\n ", "\n")


V = lines("v", POINTS)
ONES = [[n + 1 for n in face] for face in TRIANGLES]
QUADS_FROM_1 = [[n + 1 for n in face] for face in QUADS]
F = lines("f", ONES)
NORMALS = lines("vn", [(1, 0, 0)] * 3)
COORDINATES = lines("vt", [(0, 1), (1, 0)])


def interleaved(vertices, faces):
    """Each face directly after the vertices it uses, with relative numbers."""
    text = ""
    for count, face in enumerate(faces, 1):
        text += lines("v", [vertices[n] for n in face]) + lines("f", [range(-len(face), 0)])
        text += f"g {count}\n"
    return text


OBJ = {
    "plain": V + F,
    "polygons": V + lines("f", QUADS_FROM_1),
    "no line end": (V + F).rstrip(),
    "continued lines": V + F.replace(" ", " \\\n "),
    "continued vertices": V.replace(" 1\n", " \\\r\n\t1\n") + F,
    "continued without blanks": V + F.replace(" ", "\\\n", 1),
    "comment that ends in a backslash": "# C:\\meshes\\\n" + V + "# faces \\\n" + F,
    "material file that ends in a backslash": "mtllib C:\\meshes\\\n" + V + "usemtl a\\\n" + F,
    "comments at line ends": V.replace("\n", " # a vertex\n") + F.replace("\n", "# 1/2\n"),
    "comment that looks like a vertex": V + "# v 1 2 3\n" + F,
    "blank lines": V.replace("\n", "\n\n") + "\n  \t\n" + F.replace("\n", "\n\n\n"),
    "carriage returns": (V + F).replace("\n", "\r\n"),
    "carriage returns alone": (V + F).replace("\n", "\r"),
    "tabs": (V + F).replace(" ", "\t"),
    "blanks at both ends": (V + F).replace("\n", "  \n\t "),
    "byte order mark": "\ufeff" + V + F,
    "negative numbers": V + lines("f", [[n - 8 for n in face] for face in QUADS]),
    "negative numbers between vertices": interleaved(POINTS, QUADS),
    "faces before vertices": F + V,
    "normals": NORMALS + V + lines("f", QUADS_FROM_1, "{}//1"),
    "coordinates": COORDINATES + V + lines("f", QUADS_FROM_1, "{}/2"),
    "coordinates and normals": COORDINATES + NORMALS + V + lines("f", ONES, "{}/1/3"),
    "negative normals": NORMALS + V + lines("f", ONES, "{}//-3"),
    "slash without a number": V + lines("f", ONES, "{}/"),
    "colours": lines("v", [(*point, 0.5, 0.25, 1) for point in POINTS]) + F,
    "colours with alpha": lines("v", [(*point, 0.5, 0.25, 1, 1) for point in POINTS]) + F,
    "weight of 1": lines("v", [(*point, "1.0") for point in POINTS]) + F,
    "groups and materials": f"mtllib a.mtl\no box\ng one two\n{V}s off\nusemtl a\n{F}",
    "lines and points": V + "l 1 2 3\np 1 2\n" + F + "l 1/1 8/2\n",
    "curves": V + "vp 0.5 0.5\ncstype bezier\ndeg 3\ncurv 0 1 1 2 3 4\nend\n" + F,
    "degenerate face": V + F + "f 1 1 2\n",
    "face of two corners": V + F + "f 1 2\n",
    "exponents": V.replace("-1", "-1.000e+00").replace(" 1", " +.1E1") + F,
    "unused point": V + "v 0 0 0\n" + F,
    "text in Latin-1": "o B\xfchne\n" + V + F,
}

OFF_POINTS = lines("", POINTS)
OFF_FACES = lines("4", QUADS)
OFF = {
    "plain": "OFF\n8 6 12\n" + OFF_POINTS + OFF_FACES,
    "triangles": "OFF\n8 12 0\n" + OFF_POINTS + lines("3", TRIANGLES),
    "counts on the first line": "OFF 8 6 12\n" + OFF_POINTS + OFF_FACES,
    "without edges": "OFF\n8 6\n" + OFF_POINTS + OFF_FACES,
    "without keyword": "8 6 12\n" + OFF_POINTS + OFF_FACES,
    "lower case": "off\n8 6 12\n" + OFF_POINTS + OFF_FACES,
    "comments": "OFF # box\n# of 8\n8 6 12 # counts\n"
    + OFF_POINTS.replace("\n", " # point\n")
    + "# faces\n"
    + OFF_FACES,
    "comment before": "# box\nOFF\n8 6 12\n" + OFF_POINTS + OFF_FACES,
    "blank lines": "\nOFF\n\n8 6 12\n\n" + OFF_POINTS.replace("\n", "\n\n") + OFF_FACES + "\n\n",
    "carriage returns": ("OFF\n8 6 12\n" + OFF_POINTS + OFF_FACES).replace("\n", "\r\n"),
    "tabs": ("OFF\n8 6 12\n" + OFF_POINTS + OFF_FACES).replace(" ", "\t"),
    "colours": "COFF\n8 6 12\n" + OFF_POINTS.replace("\n", " 255 0 128 255\n") + OFF_FACES,
    "normals": "NOFF\n8 6 12\n" + OFF_POINTS.replace("\n", " 0 0 1\n") + OFF_FACES,
    "coordinates": "STOFF\n8 6 12\n" + OFF_POINTS.replace("\n", " 0 1\n") + OFF_FACES,
    "all": "STCNOFF 8 6 12\n" + OFF_POINTS.replace("\n", " 0 0 1 1 1 1 1 0 1\n") + OFF_FACES,
    "coloured faces": "OFF\n8 6 12\n" + OFF_POINTS + OFF_FACES.replace("\n", " 255 0 128\n"),
    "faces coloured by number": "OFF\n8 6 12\n" + OFF_POINTS + OFF_FACES.replace("\n", " 3\n"),
    "faces of one and two corners": "OFF\n8 8 12\n" + OFF_POINTS + OFF_FACES + "2 0 1\n1 0\n",
}


def ply(vertices, faces, *, form="ascii", between="", face="element face", properties=None):
    """A file of lines or bytes; `between`: lines of the header after the format."""
    properties = properties or ["float x", "float y", "float z"]
    head = f"ply\nformat {form} 1.0\n{between}element vertex 8\n"
    head += "".join(f"property {text}\n" for text in properties)
    head += f"{face}\nend_header\n"
    return head.encode() + vertices + faces


FACE = "element face 6\nproperty list uchar int vertex_indices"
PLY_POINTS = OFF_POINTS.encode()
PLY_FACES = OFF_FACES.encode()


def packed(order, kind, count_kind="B", index_kind="i", faces=QUADS):
    """The bytes of the vertices and of the faces."""
    points = b"".join(struct.pack(f"{order}3{kind}", *point) for point in POINTS)
    rows = [
        struct.pack(f"{order}{count_kind}{len(face)}{index_kind}", len(face), *face)
        for face in faces
    ]
    return points, b"".join(rows)


LITTLE = "binary_little_endian"
BIG = "binary_big_endian"
DOUBLES = ["double x", "double y", "double z"]
STRIP = "element tristrips {} \nproperty list int int vertex_indices"
PLAIN_PLY = ply(PLY_POINTS, PLY_FACES, face=FACE)
CODES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I"}
CODES |= {"int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I"}
PLY = {
    "plain": PLAIN_PLY,
    "old name of the list": PLAIN_PLY.replace(b"vertex_indices", b"vertex_index"),
    "blank lines": ply(PLY_POINTS + b"\n\n", PLY_FACES.replace(b"\n", b"\n \n"), face=FACE),
    "comments": ply(PLY_POINTS, PLY_FACES, face=FACE, between="comment end_header\nobj_info 1\n"),
    "carriage returns": PLAIN_PLY.replace(b"\n", b"\r\n"),
    "carriage returns alone": PLAIN_PLY.replace(b"\n", b"\r"),
    "tabs": ply(PLY_POINTS.replace(b" ", b"\t"), PLY_FACES, face=FACE),
    "no line end": PLAIN_PLY.rstrip(),
    "faces before vertices": b"ply\nformat ascii 1.0\n"
    + FACE.encode()
    + b"\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    + PLY_FACES
    + PLY_POINTS,
    "other order of coordinates": ply(
        b"".join(b"7 %d %d %d 5 6\n" % (z, x, y) for x, y, z in POINTS),
        PLY_FACES,
        face=FACE,
        properties=["uchar quality", "float z", "float x", "float y", "list uchar int others"],
    ).replace(b" 5 6\n", b" 1 6\n"),
    "further elements": ply(
        PLY_POINTS,
        PLY_FACES + b"3 1 2\n",
        face=FACE + "\nelement edge 1\nproperty list uchar int vertices\nproperty int b",
    ).replace(b"\n3 1 2\n", b"\n1 1 2\n"),
    "further lists of faces": ply(
        PLY_POINTS,
        b"".join(b"2 0 1 4 %d %d %d %d 9\n" % face for face in QUADS),
        face="element face 6\nproperty list uchar float texcoord\n"
        "property list uchar int vertex_indices\nproperty int flags",
    ),
    "strips": ply(
        PLY_POINTS,
        b"".join(b"%d %s\n" % (len(s), " ".join(map(str, s)).encode()) for s in STRIPS),
        face=STRIP.format(2),
    ),
    "strip with restarts": ply(
        *packed("<", "f", "i", "i", [[*STRIPS[0], -1, *STRIPS[1]]]),
        form=LITTLE,
        face=STRIP.format(1),
    ),
    "binary": ply(*packed("<", "f"), form=LITTLE, face=FACE),
    "big endian": ply(*packed(">", "f"), form=BIG, face=FACE),
    "doubles": ply(*packed("<", "d"), form=LITTLE, face=FACE, properties=DOUBLES),
    "big doubles": ply(*packed(">", "d"), form=BIG, face=FACE, properties=DOUBLES),
    "whole coordinates": ply(
        *packed("<", "h"), form=LITTLE, face=FACE, properties=["short x", "short y", "short z"]
    ),
    "binary with carriage returns in the header": ply(b"", b"", form=LITTLE, face=FACE).replace(
        b"\n", b"\r\n"
    )
    + b"".join(packed("<", "f")),
    "triangles and quads": ply(
        *packed("<", "f", faces=[*QUADS[:3], *TRIANGLES[6:]]),
        form=LITTLE,
        face=FACE.replace("6", "9"),
    ),
    "face of two corners": ply(
        *packed("<", "f", faces=[*QUADS[:3], (0, 1), (), *QUADS[3:]]),
        form=LITTLE,
        face=FACE.replace("6", "8"),
    ),
    "bytes after the end": ply(*packed("<", "f"), form=LITTLE, face=FACE) + b"\n",
}
for count_kind, count_code in CODES.items():
    for index_kind, index_code in CODES.items():
        order, form = ("<", LITTLE) if count_code.islower() else (">", BIG)
        PLY[f"lists of {count_kind} {index_kind}"] = ply(
            *packed(order, "f", count_code, index_code),
            form=form,
            face=f"element face 6\nproperty list {count_kind} {index_kind} vertex_indices",
        )

FACET = "facet normal 0 0 1\n outer loop\n{} endloop\nendfacet\n"
CORNERS = [[POINTS[n] for n in face] for face in TRIANGLES]
FACETS = [FACET.format(lines("  vertex", face)) for face in CORNERS]
TEXT_STL = f"solid box\n{''.join(FACETS)}endsolid box\n"


def binary_stl(header=b"", attributes=0):
    rows = [
        struct.pack("<12fH", 0, 0, 1, *(x for point in face for x in point), attributes)
        for face in CORNERS
    ]
    return header.ljust(80, b"\0") + struct.pack("<I", len(rows)) + b"".join(rows)


STL = {
    "text": TEXT_STL,
    "upper case": TEXT_STL.upper(),
    "carriage returns": TEXT_STL.replace("\n", "\r\n"),
    "tabs": TEXT_STL.replace(" ", "\t"),
    "blank lines": TEXT_STL.replace("\n", "\n\n"),
    "without a name": TEXT_STL.replace(" box", ""),
    "exponents": TEXT_STL.replace("-1", "-1.000000e+000"),
    "two solids": f"solid a\n{''.join(FACETS[:5])}endsolid a\nsolid b\n{''.join(FACETS[5:])}endsolid b\n",
    "binary": binary_stl(),
    "binary that begins with solid": binary_stl(b"solid box"),
    "binary with attributes": binary_stl(b"COLOR=\xff\xff\xff\xff", 0x8000),
}

FILES = {"obj": OBJ, "off": OFF, "ply": PLY, "stl": STL}


def content(kind, name):
    """The bytes of a file."""
    data = FILES[kind][name]
    if isinstance(data, bytes):
        return data
    return data.encode("utf-8" if data.startswith("\ufeff") else "latin-1")
