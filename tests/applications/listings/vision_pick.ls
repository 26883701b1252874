/PROG  VISION_PICK
/ATTR
OWNER		= MNEDITOR;
COMMENT		= "";
PROG_SIZE	= 1204;
PROTECT		= READ_WRITE;
TCD:  STACK_SIZE	= 0,
      TASK_PRIORITY	= 50;
DEFAULT_GROUP	= 1,*,*,*,*;
CONTROL_CODE	= 00000000 00000000;
/APPL
/MN
   1:  UTOOL_NUM=3 ;
   2:  VISION GET_OFFSET 'PICK' VR[1] JMP LBL[9] ;
   3:J P[1] 100% CNT50    ;
   4:L P[2] 500mm/sec FINE VOFFSET,VR[1]    ;
   5:L P[3] 100mm/sec FINE Offset,PR[7:shift]    ;
   6:L P[3] 100mm/sec FINE Tool_Offset,PR[8] TA .10sec,CALL GRIP    ;
   7:L P[1] 500mm/sec CNT100    ;
   8:  LBL[9:no part] ;
/POS
P[1]{
   GP1:
	UF : 2, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =  -145.403  mm,	Y =  2115.555  mm,	Z =  2076.004  mm,
	W =   -41.105 deg,	P =   -48.098 deg,	R =   124.470 deg
};
P[2]{
   GP1:
	UF : 2, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =   258.739  mm,	Y =  1872.358  mm,	Z =  2142.529  mm,
	W =   -40.279 deg,	P =   -50.319 deg,	R =   121.524 deg
};
P[3]{
   GP1:
	UF : 2, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =   -20.867  mm,	Y =  1844.280  mm,	Z =  2074.074  mm,
	W =   -55.037 deg,	P =   -46.969 deg,	R =   131.439 deg
};
/END
