"""The English and German words of lists of registers."""

import re
from typing import Final

COLUMNS: Final = {
    "name": (
        *("name", "names", "signal", "signals", "tag", "tags", "tag name", "label", "variable", "variables", "symbol"),
        *("signal name", "bezeichnung", "bezeichner", "variablen", "signalname", "datenpunkt", "messgröße", "point"),
    ),
    "table": (
        *("table", "tables", "space", "area", "areas", "kind", "register type", "registertyp", "bereich", "tabelle"),
        *("registerart", "register", "object type", "art"),
    ),
    "address": (
        *("address", "addresses", "addr", "offset address", "adresse", "adressen", "register address"),
        *("registeradresse", "modbus address", "modbus adresse", "modbusadresse", "start address", "startadresse"),
        *("register number", "reg", "register", "registernummer"),
    ),
    "type": (
        *("type", "types", "encoding", "format", "formats", "datatype", "datatypes", "data type", "data types"),
        *("datentyp", "datentypen", "typ", "datenformat"),
    ),
    "scale": (
        *("scale", "scales", "scaling", "resolution", "lsb", "skalierung", "auflösung", "multiplier", "multiplikator"),
    ),
    "factor": (
        *("factor", "factors", "faktor", "faktoren", "scale factor", "scale factors", "scaling factor", "scalefactor"),
        *("skalierungsfaktor", "umrechnungsfaktor", "conversion factor", "sf"),
    ),
    "exponent": (
        *("exponent", "exponents", "exp", "scale exponent", "power of ten", "power of 10", "zehnerpotenz"),
        *("10 exponent", "scaling exponent", "scale power"),
    ),
    "size": (
        *("size", "sizes", "length", "len", "words", "word count", "register count", "no of registers", "bytes"),
        *("number of registers", "registers count", "count", "quantity", "bits", "size bits", "size bytes"),
        *("length bits", "length bytes", "länge", "größe", "anzahl", "anzahl register", "registeranzahl"),
    ),
    "null": (
        *("no value", "null", "null value", "invalid value", "error value", "not available", "sna", "fehlwert"),
        *("fehlerwert", "ungültig", "kein wert", "ersatzwert"),
    ),
    "divisor": ("divisor", "divisors", "div", "divider", "scale divisor", "teiler"),
    "order": (
        *("word order", "byte order", "wordorder", "byteorder", "endian", "endianness", "wortreihenfolge"),
        *("bytereihenfolge",),
    ),
    "function": ("function", "function code", "functions", "function codes", "fc", "funktion", "funktionscode"),
    "bit": ("bit", "bit number", "bit no", "bitnummer"),
    "unit": ("unit", "units", "engineering unit", "engineering units", "eu", "einheit", "einheiten"),
    "access": (
        *("access", "access type", "access right", "access rights", "r w", "rw", "read write", "permission"),
        *("permissions", "zugriff", "zugriffsart", "zugriffsrecht", "lesen schreiben", "l s"),
    ),
    "text": (
        *("description", "descriptions", "comment", "comments", "text", "meaning", "remark", "remarks"),
        *("beschreibung", "kommentar", "bemerkung", "bedeutung"),
    ),
}  # fmt: skip
TABLES: Final = {
    "input": (
        *("input", "inputs", "ir", "3x", "3xxxx", "input register", "input registers", "analog input", "ai"),
        *("eingang", "eingänge", "eingangsregister", "fc4", "fc04"),
    ),
    "holding": (
        *("holding", "holdings", "hr", "4x", "4xxxx", "holding register", "holding registers", "halteregister"),
        *("haltende register", "fc3", "fc03"),
    ),
    "coil": ("coil", "coils", "0x", "0xxxx", "do", "spule", "spulen", "fc1", "fc01"),
    "discrete": (
        *("discrete", "discretes", "di", "1x", "1xxxx", "discrete input", "discrete inputs", "contact", "contacts"),
        *("diskreter eingang", "diskrete eingänge", "digitaleingang", "digitaleingänge", "fc2", "fc02"),
    ),
}  # fmt: skip
#: Whether a point can be read, and whether it can be written.
ACCESS: Final = {
    **dict.fromkeys(("r", "ro", "read", "read only", "readonly", "lesen", "nur lesen", "l"), (True, False)),
    **dict.fromkeys(("w", "wo", "write", "write only", "writeonly", "schreiben", "nur schreiben", "s"), (False, True)),
    **dict.fromkeys(("rw", "wr", "r w", "w r", "read write", "readwrite", "read and write"), (True, True)),
    **dict.fromkeys(("lesen schreiben", "lesen und schreiben", "ls", "l s", "lesend schreibend"), (True, True)),
}  # fmt: skip
#: Functions that write.
WRITING: Final = frozenset({"5", "6", "15", "16", "22", "23"})
#: Ambiguous columns, each with the cell that changes no number, and with advice for the user.
OPEN: Final = {
    **dict.fromkeys(("gain", "gains"), ("1", "a gain may multiply or divide; use a column scale or divisor")),
    **dict.fromkeys(
        ("offset", "value offset", "offset value", "versatz"),
        (
            "0",
            "remove the column, and state offset = … of the point in the wiring",
        ),
    ),
    **dict.fromkeys(
        ("decimals", "decimal", "decimal places", "nachkommastellen", "dezimalstellen", "dezimale"),
        ("0", "decimals may be a display format or a scale; use a column scale, such as 0.1"),
    ),
}
#: Column headings that always mean changed numbers, whatever the cells are.
SCALING: Final = re.compile(
    r"scal|skal|fa[ck]tor|expon|\bexp\b|\bsf\b|gain|mult|divi|teiler|resol|auflös|precis|genauig|conver|umrech|"
    r"formul|formel|offset|versatz|decim|dezimal|nachkomma|10\^|power|potenz|\blsb\b"
)
DEVICES: Final = (
    "slave",
    "slave id",
    "slaveid",
    "unit id",
    "unitid",
    "device id",
    "station",
    "geräteadresse",
)
#: The read function for each write function.
READ_BY: Final = {"5": "1", "15": "1", "6": "3", "16": "3"}
#: First digit of a Modicon number, by table.
DIGIT: Final = {"coil": "0", "discrete": "1", "input": "3", "holding": "4"}
TYPES: Final = {
    **dict.fromkeys(("bit", "bool", "boolean"), "bit"),
    **dict.fromkeys(("uint16", "word", "uint", "u16", "unsigned16", "ushort", "unsignedint16"), "uint16"),
    **dict.fromkeys(("int16", "int", "sint16", "s16", "i16", "signed16", "short", "signedint16"), "int16"),
    **dict.fromkeys(("uint32", "dword", "udint", "u32", "unsigned32", "ulong", "unsignedint32"), "uint32"),
    **dict.fromkeys(("int32", "dint", "sint32", "s32", "i32", "signed32", "long", "signedint32"), "int32"),
    **dict.fromkeys(("uint64", "u64", "ulint", "lword"), "uint64"),
    **dict.fromkeys(("int64", "s64", "i64", "lint"), "int64"),
    **dict.fromkeys(("float32", "float", "real", "single", "f32", "real32", "ieee754"), "float32"),
    **dict.fromkeys(("float64", "double", "lreal", "f64", "real64"), "float64"),
}
#: Order of the bytes A (the highest) to D of 32 bits on the wire: order of the words, order of the bytes in a word.
ORDERS: Final = {
    "abcd": ("high", "big"),
    "cdab": ("low", "big"),
    "badc": ("high", "little"),
    "dcba": ("low", "little"),
    "abcdefgh": ("high", "big"),
    "ghefcdab": ("low", "big"),
}
WORDS: Final = {
    **{order: order for order in ORDERS},
    **dict.fromkeys(("big endian", "be", "msw first", "high word first"), "abcd"),
    **dict.fromkeys(("word swapped", "word swap", "swapped", "lsw first", "low word first"), "cdab"),
}
