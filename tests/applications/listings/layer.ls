/PROG  LAYER
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
:SR[30]=52.5;
:R[34]=0;
1: L @P[1] 240cm/min CNT100 ;
: Weave Sine[5];
2: L P[2] WELD_SPEED CNT100 PTH ;
3:	J P[3] 50% CNT60 Tool_Offset,PR[15] 	;
4:  J  P[4] 50% FINE ;
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
P[4]{
   GP1:
	UF : 2, UT : 3,	
	J1=    27.199 deg,	J2=    36.801 deg,	J3=   -17.124 deg,
	J4=    -3.116 deg,	J5=    64.026 deg,	J6=    -4.209 deg
};
/END
