/* The plain loops of METHOD §2, compiled: the same integers as possmap/core/stamping.py.

   Doubles are computed in the order in which METHOD §2 writes them and must not be contracted
   (-ffp-contract=off). Segments come as rows of doubles (possmap/core/segment_table.py), pieces as
   rows of 64-bit integers (possmap/core/kernel.py); arrays cross the border as buffers, so that
   this file needs neither NumPy's headers nor its ABI. */

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030b0000
#include <Python.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define HAIR 1e-6        /* lattice.HAIR */
#define FULL 65535.0     /* pyramid.FULL */
#define TILE 256         /* lattice.TILE */
#define AT_ONCE 512      /* stamping.LISTED_AT_ONCE */
#define LANES 8          /* 16-bit numbers in the narrowest vector of today's machines */

enum {
    X0, Y0, X1, Y1, HALF_X0, HALF_Y0, HALF_X1, HALF_Y1, MAX_ERROR, WIDTH, IS_POINT, FACTOR, COLUMNS
};
enum { SEGMENT, FIRST, LAST, GROUP, KNOWN, CLIP, PIECE_COLUMNS };

typedef int64_t i64;

typedef struct {
    i64 row, column;
    double half_x, half_y;
} Stamp;

typedef struct { /* values of the cells of a window, and its place on the lattice */
    uint16_t *values;
    i64 row0, column0, rows, columns;
} Block;

static i64 least(i64 a, i64 b) { return a < b ? a : b; }
static i64 most(i64 a, i64 b) { return a > b ? a : b; }

/* ------------------------------------------------------------------ the stamps of a segment */

static i64 count_of(const double *s, double c) /* pyramid.count_of */
{
    double longest = fmax(fabs(s[X1] - s[X0]), fabs(s[Y1] - s[Y0]));
    return most(1, (i64)ceil(longest / c - HAIR));
}

static Stamp stamp_at(const double *s, i64 n, i64 k, double c) /* pyramid.stamps */
{
    double share = (double)k / (double)n;
    Stamp at;
    at.row = (i64)floor((s[Y0] + share * (s[Y1] - s[Y0])) / c + HAIR);
    at.column = (i64)floor((s[X0] + share * (s[X1] - s[X0])) / c + HAIR);
    at.half_x = s[HALF_X0] + share * (s[HALF_X1] - s[HALF_X0]);
    at.half_y = s[HALF_Y0] + share * (s[HALF_Y1] - s[HALF_Y0]);
    return at;
}

static i64 reach_of(double half, double c) { return (i64)ceil(half / c + 0.5) - 1; }

static int too_wide(const double *s, i64 n, i64 k)
{
    double share = (double)k / (double)most(1, n);
    for (int side = 0; side < 2; side++) {
        double half0 = s[HALF_X0 + side], half1 = s[HALF_X1 + side];
        if (half0 + share * (half1 - half0) >= s[MAX_ERROR]) return 1;
    }
    return 0;
}

static void span_of(const double *s, double c, i64 *first, i64 *last) /* pyramid.relevant */
{
    i64 n = s[IS_POINT] != 0 ? 0 : count_of(s, c);
    double limit = s[MAX_ERROR];
    *first = 0, *last = n;
    for (int side = 0; side < 2; side++) {
        double half0 = s[HALF_X0 + side], half1 = s[HALF_X1 + side];
        if (fmin(half0, half1) >= limit) {
            *first = 0, *last = -1;
            return;
        }
        if (fmax(half0, half1) > limit) {
            double crossing = (double)n * ((limit - half0) / (half1 - half0));
            if (half1 > half0)
                *last = least(*last, (i64)ceil(crossing) + 1);
            else
                *first = most(*first, (i64)floor(crossing) - 1);
        }
    }
    while (*first <= *last && too_wide(s, n, *first)) ++*first;
    while (*first <= *last && too_wide(s, n, *last)) --*last;
    if (*first > *last) *first = 0, *last = -1;
}

/* ------------------------------------------------------------------ the pyramid of a stamp */

/* Return the profile of the cells from..to-1 along one axis: floor(65535·N + 0.5) of each, and
   then a vector of zeros. It is the same on both sides of the centre: computed once, and written
   both ways from the middle of a room for two sides. */
static const uint16_t *profile(uint16_t *middle, i64 from, i64 to, i64 centre, double half,
                               double max_error, double c)
{
    double height = 1 - half / max_error, base = half + c / 2;
    height = height > 0 ? height : 0;
    i64 before = from - centre, after = to - 1 - centre;
    i64 nearest = before > 0 ? before : after < 0 ? -after : 0;
    double start = (double)nearest;
    int count = (int)(most(-before, after) - nearest + 1);
    for (int i = 0; i < count; i++) {
        double slope = 1 - (start + i) * c / base;
        slope = slope > 0 ? slope : 0;
        middle[i] = middle[-i] = (uint16_t)(int)(FULL * (height * slope) + 0.5);
    }
    uint16_t *out = before > 0 ? middle : middle + before + nearest;
    memset(out + (to - from), 0, LANES * sizeof *out);
    return out;
}

/* Raise so many times so many cells of a line to the least of ``across`` and ``up``. The plainest
   vectors of 16 bits know a maximum and no minimum, hence the sum. */
static inline void raise_line(uint16_t *restrict line, const uint16_t *restrict across, uint16_t up,
                              i64 times, i64 cells)
{
    for (; times > 0; times--, line += cells, across += cells)
        for (i64 j = 0; j < cells; j++) {
            uint16_t larger = across[j] > up ? across[j] : up;
            uint16_t value = (uint16_t)(across[j] + up - larger);
            line[j] = line[j] > value ? line[j] : value;
        }
}

/* Raise a block to the maximum of itself and the stamps first..last of a segment. ``room`` holds
   four times the block's longer side. */
static void raise_block(const Block *b, const double *s, i64 first, i64 last, double c,
                        uint16_t *room)
{
    i64 n = count_of(s, c), longer = most(b->rows, b->columns) + LANES;
    const uint16_t *end = b->values + b->rows * b->columns;
    for (i64 k = first; k <= last; k++) {
        Stamp at = stamp_at(s, n, k, c);
        i64 reach_rows = reach_of(at.half_y, c), reach_columns = reach_of(at.half_x, c);
        i64 bottom = most(at.row - reach_rows, b->row0);
        i64 top = least(at.row + reach_rows + 1, b->row0 + b->rows);
        i64 left = most(at.column - reach_columns, b->column0);
        i64 right = least(at.column + reach_columns + 1, b->column0 + b->columns);
        if (bottom >= top || left >= right) continue;
        const uint16_t *up =
            profile(room + longer, bottom, top, at.row, at.half_y, s[MAX_ERROR], c);
        const uint16_t *across =
            profile(room + 3 * longer, left, right, at.column, at.half_x, s[MAX_ERROR], c);
        /* Whole vectors: beyond the stamp they raise to 0, which changes nothing. */
        i64 whole = (right - left + LANES - 1) / LANES * LANES;
        uint16_t *line = b->values + (bottom - b->row0) * b->columns + (left - b->column0);
        for (i64 row = 0; row < top - bottom; row++, line += b->columns) {
            if (whole <= end - line)
                raise_line(line, across, up[row], whole / LANES, LANES);
            else
                raise_line(line, across, up[row], 1, right - left);
        }
    }
}

/* ------------------------------------------------------------------ what Python calls */

#define FARTHEST 4e15 /* cells: beyond, doubles know no single cell */

/* Whether a buffer is whole rows of doubles that can be cells; sets an error if not. */
static int are_segments(const Py_buffer *segments, double c)
{
    const double *s = segments->buf;
    i64 count = segments->len / (i64)(COLUMNS * sizeof(double));
    int sound = segments->itemsize == (Py_ssize_t)sizeof(double)
                && segments->len % (i64)(COLUMNS * sizeof(double)) == 0 && c > 0 && isfinite(c);
    for (; sound && count > 0; count--, s += COLUMNS) {
        double widest = 0;
        for (int i = 0; i < COLUMNS; i++) sound = sound && isfinite(s[i]);
        for (int i = X0; i <= Y1; i++) sound = sound && fabs(s[i]) < FARTHEST * c;
        for (int i = HALF_X0; i <= HALF_Y1; i++) widest = s[i] > widest ? s[i] : widest;
        sound = sound && (widest < FARTHEST * c || s[MAX_ERROR] < FARTHEST * c);
    }
    if (!sound) PyErr_SetString(PyExc_ValueError, "segments that are on no lattice");
    return sound;
}

typedef struct {
    Py_buffer block, segments, pieces;
    Block b;
    uint16_t *room;
} Call;

static int open_call(Call *call, PyObject *block, PyObject *segments, PyObject *pieces,
                     Py_ssize_t cell, double c)
{
    const Block *b = &call->b;
    memset(&call->block, 0, sizeof call->block);
    memset(&call->segments, 0, sizeof call->segments);
    memset(&call->pieces, 0, sizeof call->pieces);
    call->room = NULL;
    if (PyObject_GetBuffer(block, &call->block, PyBUF_WRITABLE | PyBUF_C_CONTIGUOUS) < 0
        || PyObject_GetBuffer(segments, &call->segments, PyBUF_C_CONTIGUOUS) < 0
        || PyObject_GetBuffer(pieces, &call->pieces, PyBUF_C_CONTIGUOUS) < 0)
        return -1;
    if (!are_segments(&call->segments, c)) return -1;
    if (call->pieces.len % (i64)(PIECE_COLUMNS * sizeof(i64)))
        return PyErr_SetString(PyExc_ValueError, "pieces that are no whole rows"), -1;
    i64 count = call->segments.len / (i64)(COLUMNS * sizeof(double));
    i64 listed = call->pieces.len / (i64)(PIECE_COLUMNS * sizeof(i64));
    const i64 *piece = call->pieces.buf;
    if (b->rows <= 0 || b->columns <= 0 || call->block.len / cell / b->columns != b->rows
        || call->block.len % (cell * b->columns))
        return PyErr_SetString(PyExc_ValueError, "the block is not of its window's shape"), -1;
    for (i64 i = 0; i < listed; i++, piece += PIECE_COLUMNS)
        if (piece[SEGMENT] < 0 || piece[SEGMENT] >= count)
            return PyErr_SetString(PyExc_IndexError, "a piece of no segment"), -1;
    call->room = malloc(4 * (most(b->rows, b->columns) + LANES) * sizeof(uint16_t));
    return call->room ? 0 : (PyErr_NoMemory(), -1);
}

static PyObject *close_call(Call *call, int sound)
{
    free(call->room);
    PyBuffer_Release(&call->block);
    PyBuffer_Release(&call->segments);
    PyBuffer_Release(&call->pieces);
    if (!sound) return NULL;
    Py_RETURN_NONE;
}

/* raise_(block, row0, column0, rows, columns, segments, pieces, resolution) */
static PyObject *raise_(PyObject *self, PyObject *args)
{
    Call call;
    PyObject *block, *segments, *pieces;
    double c;
    long long row0, column0, rows, columns;
    (void)self;
    if (!PyArg_ParseTuple(args, "OLLLLOOd", &block, &row0, &column0, &rows, &columns, &segments,
                          &pieces, &c))
        return NULL;
    call.b = (Block){NULL, row0, column0, rows, columns};
    if (open_call(&call, block, segments, pieces, sizeof(uint16_t), c) < 0) return close_call(&call, 0);
    call.b.values = call.block.buf;
    const double *s = call.segments.buf;
    const i64 *piece = call.pieces.buf, *end = piece + call.pieces.len / (i64)sizeof(i64);
    for (; piece < end; piece += PIECE_COLUMNS)
        raise_block(&call.b, s + piece[SEGMENT] * COLUMNS, piece[FIRST], piece[LAST], c, call.room);
    return close_call(&call, 1);
}

/* Grow low..high by the rows, and columns, that a piece may touch (stamping.extent): cells are
   monotone along a segment, and so are reaches, but not always both together. */
static void extend(i64 low[2], i64 high[2], const double *s, const i64 *piece, double c)
{
    i64 n = count_of(s, c);
    Stamp one = stamp_at(s, n, piece[FIRST], c), other = stamp_at(s, n, piece[LAST], c);
    i64 rows = most(reach_of(one.half_y, c), reach_of(other.half_y, c));
    i64 columns = most(reach_of(one.half_x, c), reach_of(other.half_x, c));
    low[0] = least(low[0], least(one.row, other.row) - rows);
    low[1] = least(low[1], least(one.column, other.column) - columns);
    high[0] = most(high[0], most(one.row, other.row) + rows + 1);
    high[1] = most(high[1], most(one.column, other.column) + columns + 1);
}

/* Add to weights, or take from them, the weight of every value of the block between low and high. */
static void weigh(i64 *weights, const Block *b, const i64 low[2], const i64 high[2], const i64 *table,
                  int sign)
{
    for (i64 row = low[0]; row < high[0]; row++)
        for (i64 at = row * b->columns + low[1]; at < row * b->columns + high[1]; at++)
            if (b->values[at]) weights[at] += sign * table[b->values[at]];
}

/* reinforce(weights, row0, column0, rows, columns, segments, pieces, resolution, table): fusion's
   sum over the groups of pieces; the known ones of a group come first. */
static PyObject *reinforce(PyObject *self, PyObject *args)
{
    Call call;
    PyObject *block, *segments, *pieces, *table_object;
    Py_buffer table;
    double c;
    long long row0, column0, rows, columns;
    (void)self;
    if (!PyArg_ParseTuple(args, "OLLLLOOdO", &block, &row0, &column0, &rows, &columns, &segments,
                          &pieces, &c, &table_object)
        || PyObject_GetBuffer(table_object, &table, PyBUF_C_CONTIGUOUS) < 0)
        return NULL;
    call.b = (Block){NULL, row0, column0, rows, columns};
    int sound = open_call(&call, block, segments, pieces, sizeof(i64), c) == 0;
    if (sound && table.len != 65536 * (Py_ssize_t)sizeof(i64)) {
        PyErr_SetString(PyExc_ValueError, "not a table of 65536 weights");
        sound = 0;
    }
    if (sound) {
        call.b.values = calloc((size_t)(rows * columns) + LANES, sizeof(uint16_t));
        if (!call.b.values) PyErr_NoMemory(), sound = 0;
    }
    const double *s = call.segments.buf;
    const i64 *piece = call.pieces.buf, *end = piece + call.pieces.len / (i64)sizeof(i64);
    while (sound && piece < end) {
        const i64 *next = piece;
        i64 low[2] = {INT64_MAX, INT64_MAX}, high[2] = {INT64_MIN, INT64_MIN};
        for (; next < end && next[GROUP] == piece[GROUP]; next += PIECE_COLUMNS)
            extend(low, high, s + next[SEGMENT] * COLUMNS, next, c);
        low[0] = most(low[0] - row0, 0), high[0] = least(high[0] - row0, rows);
        low[1] = most(low[1] - column0, 0), high[1] = least(high[1] - column0, columns);
        for (int known = 1; known >= 0; known--) {
            int any = 0;
            for (const i64 *one = piece; one < next; one += PIECE_COLUMNS)
                if ((one[KNOWN] != 0) == known) {
                    raise_block(&call.b, s + one[SEGMENT] * COLUMNS, one[FIRST], one[LAST], c,
                                call.room);
                    any = 1;
                }
            if (any || !known) weigh(call.block.buf, &call.b, low, high, table.buf, known ? -1 : 1);
        }
        for (i64 row = low[0]; row < high[0]; row++)
            if (high[1] > low[1])
                memset(call.b.values + row * columns + low[1], 0,
                       (size_t)(high[1] - low[1]) * sizeof(uint16_t));
        piece = next;
    }
    if (call.room) free(call.b.values);
    PyBuffer_Release(&table);
    return close_call(&call, sound);
}

/* How many rows and columns from its centre a stamp may say something (stamping, swath.reach). */
static void reach_at(const double *s, const Stamp *at, double growth, double c, i64 *rows,
                     i64 *columns)
{
    if (s[WIDTH] > 0) {
        double metres = 2 * (at->half_x + at->half_y + growth);
        *rows = *columns = (i64)ceil((metres + fmax(s[WIDTH], c)) / c) + 1;
    } else {
        *rows = reach_of(at->half_y, c), *columns = reach_of(at->half_x, c);
    }
}

static i64 tile_of(i64 cell) { return cell >= 0 ? cell / TILE : -((-cell + TILE - 1) / TILE); }

typedef struct { i64 low_row, high_row, low_column, high_column; } Tiles;

/* touch(segments, resolution) -> bytes: rows of segment, tile row, tile column, first, last */
static PyObject *touch(PyObject *self, PyObject *args)
{
    Py_buffer segments;
    double c;
    (void)self;
    if (!PyArg_ParseTuple(args, "y*d", &segments, &c)) return NULL;
    if (!are_segments(&segments, c)) return PyBuffer_Release(&segments), NULL;
    i64 count = segments.len / (i64)(COLUMNS * sizeof(double)), held = 0, room = 5 * 1024;
    i64 *out = malloc((size_t)room * sizeof(i64));
    for (i64 i = 0; out && i < count; i++) {
        const double *s = (const double *)segments.buf + i * COLUMNS;
        i64 first, last, n = count_of(s, c);
        double growth = fabs(s[HALF_X1] - s[HALF_X0]) + fabs(s[HALF_Y1] - s[HALF_Y0]);
        span_of(s, c, &first, &last);
        for (i64 from = first; out && from <= last; from += AT_ONCE) {
            Tiles tiles[AT_ONCE], all = {INT64_MAX, INT64_MIN, INT64_MAX, INT64_MIN};
            i64 some = least(last - from + 1, AT_ONCE);
            for (i64 k = 0; k < some; k++) {
                Stamp at = stamp_at(s, n, from + k, c);
                i64 rows, columns;
                reach_at(s, &at, growth / (double)n, c, &rows, &columns);
                Tiles t = {tile_of(at.row - rows), tile_of(at.row + rows),
                           tile_of(at.column - columns), tile_of(at.column + columns)};
                all.low_row = least(all.low_row, t.low_row);
                all.high_row = most(all.high_row, t.high_row);
                all.low_column = least(all.low_column, t.low_column);
                all.high_column = most(all.high_column, t.high_column);
                tiles[k] = t;
            }
            for (i64 row = all.low_row; out && row <= all.high_row; row++)
                for (i64 column = all.low_column; out && column <= all.high_column; column++) {
                    i64 one = -1, other = -1;
                    for (i64 k = 0; k < some; k++)
                        if (tiles[k].low_row <= row && row <= tiles[k].high_row
                            && tiles[k].low_column <= column && column <= tiles[k].high_column)
                            other = k, one = one < 0 ? k : one;
                    if (one < 0) continue;
                    if (held + 5 > room) {
                        i64 *more = realloc(out, (size_t)(room *= 2) * sizeof(i64));
                        if (!more) free(out);
                        out = more;
                        if (!out) break;
                    }
                    i64 found[5] = {i, row, column, from + one, from + other};
                    memcpy(out + held, found, sizeof found);
                    held += 5;
                }
        }
    }
    PyObject *found = out ? PyBytes_FromStringAndSize((char *)out, held * (i64)sizeof(i64))
                          : PyErr_NoMemory();
    free(out);
    PyBuffer_Release(&segments);
    return found;
}

static PyMethodDef methods[] = {
    {"raise_", raise_, METH_VARARGS, "Raise a block to the maximum of itself and pieces."},
    {"reinforce", reinforce, METH_VARARGS, "Add to weights those of each group's maximum."},
    {"touch", touch, METH_VARARGS, "Return the tiles that each segment may touch."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "_stamping", "The loops of METHOD 2, compiled.", 0, methods,
    NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__stamping(void) { return PyModule_Create(&module); }
